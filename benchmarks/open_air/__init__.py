"""Open air through rendered stereo: what is called free, what is closed by nothing, what is missed."""
