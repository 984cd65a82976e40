"""YAML text -> checked document -> System, with the line of every value."""
