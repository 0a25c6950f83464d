"""The Hugging Face Hub: addresses, fetching into its cache, publishing. Knows neither policies nor trials."""
