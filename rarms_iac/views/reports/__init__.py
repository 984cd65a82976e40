"""Reports: measurements -> report model -> one HTML file, and the same as rows of a table."""
