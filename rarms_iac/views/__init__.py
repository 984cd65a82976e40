"""What a person or a program sees: views take finished values, decide nothing and return text."""
