"""Fixed and controlled step sizes, compiled loops, real-time pacing, and checkpoints."""
