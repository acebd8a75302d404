"""Is a log what it should be? One pass over it, then one small rule after the other."""
