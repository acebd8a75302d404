"""Recording in threads: what is slow never holds up what must not wait."""
