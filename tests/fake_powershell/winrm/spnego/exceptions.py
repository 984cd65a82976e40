class SpnegoError(Exception):
    pass
