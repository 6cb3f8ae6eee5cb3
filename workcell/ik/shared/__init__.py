"""What several solvers use: arrays for kernels, cone programs, joint intervals, polish."""
