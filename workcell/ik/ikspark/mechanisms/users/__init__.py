"""Users' own convex constraints: written in cvxpy, kept by the cone program, asked of every answer."""
