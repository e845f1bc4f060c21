"""Points labelled by plane, by minimising one energy: the finder `ransac`, and what `label_planes` shares with it."""
