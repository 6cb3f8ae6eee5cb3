"""Recordings for people: tables, pictures, plots and pages."""
