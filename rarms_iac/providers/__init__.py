"""Hosts: what every one of them must offer (interface.py), and one folder for each kind."""
