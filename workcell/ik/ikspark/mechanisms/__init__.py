"""IKSPARK for whole mechanisms: hinges, slides, balls and floating bodies, trees and closed loops."""
