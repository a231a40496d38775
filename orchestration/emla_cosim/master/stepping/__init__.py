"""Fixed and controlled step sizes, the loop in C, real-time pacing, and checkpoints."""
