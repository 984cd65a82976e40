"""Hyper-V hosts: what `observe.ps1` prints, and what follows from it."""
