"""Items onto hosts at least cost and then with the fewest moves: exact, with certificates, and beyond 30 with a gap."""
