"""What certificates about mechanisms prove, from the mechanism alone: sums of its ties and goals, bounded."""
