"""The relaxation for mechanisms written plainly in cvxpy, in all its forms: to read, to test against, to extend."""
