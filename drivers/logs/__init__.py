"""Reading MCAP files and the codecs of their messages."""
