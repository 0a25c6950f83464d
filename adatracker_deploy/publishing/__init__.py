"""What a policy and trials are on the Hub: their files, and their cards with the Hub's header."""
