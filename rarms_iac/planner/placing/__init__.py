"""Partitions onto hosts: few exactly, many by several ways and exact parts; always the same answer."""
