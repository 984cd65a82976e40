"""System -> Layout: which component runs in which partition on which host, with which reservation."""
