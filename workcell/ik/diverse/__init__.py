"""Several solutions of one problem, told apart by posture and distance."""
