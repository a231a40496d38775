"""Parameter sets of SSP (SSV) for FMUs and systems, and the XML of SSP documents."""
