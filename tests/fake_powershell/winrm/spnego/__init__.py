"""What rarms uses of pyspnego."""
