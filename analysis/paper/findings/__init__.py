"""What the paper found, as questions that each seed of our runs answers with yes or no."""
