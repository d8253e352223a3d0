"""Hardware and its twins: depth sources and pose sources behind two small protocols."""
