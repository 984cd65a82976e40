"""What a reviewer of a plan should see before it is done, one finding a file."""
