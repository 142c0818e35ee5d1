"""Settings of subset correlation chosen by a sweep over a few steps of a test."""
