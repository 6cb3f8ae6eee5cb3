"""What a run writes into its recording while it happens."""
