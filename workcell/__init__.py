"""workcell: a MuJoCo-simulated manipulation workcell with verified inverse kinematics in the loop."""
