"""The words of the problem: frozen values, standard library only. Everything above speaks in these."""
