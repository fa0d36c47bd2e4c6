"""What scoring tools and maps are told: where everybody is."""
