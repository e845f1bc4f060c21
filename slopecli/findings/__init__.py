"""Checks of images, matches and answers; each returns diagnostics or refuses the pair."""
