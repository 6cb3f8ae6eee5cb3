"""What benches measure against: other methods, closed forms, planted and generated problems."""
