"""Simulators and cases that share nothing with the program, to test what it claims."""
