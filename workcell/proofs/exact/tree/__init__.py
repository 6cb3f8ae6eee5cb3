"""`branch` (section 6): a tree of boxes of joint angles, walked with whole numbers, many boxes at a time.

Angles, directions and lengths are 64-bit whole numbers, counted in 2^-30 of a radian, of one, and of a unit of
length so large that everything lies within it. Every product is rounded once, in a stated direction or counted in a
stated error. Doubles are used to guess only: what combination of equations to try, where to cut. What is guessed is
proved in whole numbers.
"""
