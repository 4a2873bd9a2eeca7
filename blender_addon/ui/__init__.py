"""Drawing and input code that all topics share."""
