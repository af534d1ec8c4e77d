"""The paper's whole system: a laser that finds a spot, a main control that plans the motion to it, drives that execute it."""
