"""From step to step: fixed or controlled step sizes, compiled loops, pace, and checkpoints."""
