"""Two measurements side by side: fields brought to the same points, and their differences."""
