"""CIDGIK (Giamou et al., 2022): inverse kinematics as low-rank points of a distance-geometric relaxation."""
