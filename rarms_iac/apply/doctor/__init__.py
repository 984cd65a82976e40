"""What makes a plan void or unsafe on a host, found before it is made."""
