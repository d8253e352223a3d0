"""Hardware drivers and their simulation: depth sources and event sources behind two protocols."""
