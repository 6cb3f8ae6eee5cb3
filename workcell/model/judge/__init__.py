"""What a judge of configurations needs of a compiled model, whatever the user's options and geoms are."""
