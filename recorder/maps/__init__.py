"""Marker maps: checked, drawn, and in other tools' formats."""
