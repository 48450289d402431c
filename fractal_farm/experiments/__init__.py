"""Experiments: questions about the farm that a single run cannot answer, each run by one command and kept as a report.

`methods` compares ways to search at equal evaluations. They stand on all other layers and change none of them.
"""
