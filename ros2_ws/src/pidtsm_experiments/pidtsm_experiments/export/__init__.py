"""Files for viewers: MCAP for Foxglove and RViz, RRD for rerun."""
