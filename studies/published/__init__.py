"""What is published of three cutting experiments, as campaigns, and which blade gives all of it."""
