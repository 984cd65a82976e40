"""What a compound will probably need, from what is known of its members: guides questions, and proves nothing."""
