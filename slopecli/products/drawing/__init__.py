"""Parts that the pictures share: canvas, colours, shapes, text and their placement."""
