"""Writes what a log has for other programs: tables, tracks, MCAP.

Runs in the process of a task (`tasks.py`).
"""
