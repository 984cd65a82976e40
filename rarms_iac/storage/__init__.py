"""How bytes reach the disk: `replace` for state, `append` for records, a lock that dies with its process, digests."""
