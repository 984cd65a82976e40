"""What Ansible's `psrp` names of requests."""
