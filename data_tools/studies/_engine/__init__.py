"""Runs trials wherever there is room, keeps each, survives being killed."""
