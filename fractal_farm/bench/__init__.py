"""Measurements of the evaluator on the machine at hand: speed against its limits and its peers, and accuracy.

`farm bench` prints them. Ratios are taken within one run; times are the shortest of several runs, in the processor time
of the thread, so that other work on the machine disturbs them little.
"""
