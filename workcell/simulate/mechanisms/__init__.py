"""Mechanisms in motion: their motors driven, their ties and contacts watched, all of it logged."""
