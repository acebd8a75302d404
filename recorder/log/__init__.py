"""The log: one MCAP file that holds everything that entered."""
