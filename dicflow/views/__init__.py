"""Figures, pictures and films from products, and the terminal."""
