"""Flows: engines, methods, steppers, stops and constraints, in terms of free coordinates u and their rate."""
