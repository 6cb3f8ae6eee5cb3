"""Damped Newton polish in a Warp thread: trust radius, backtracking, dogleg, single joint.

Section IV, Eqs. 12-16 of HJCD-IK (see `workcell.ik.hjcd.solver`).
"""
# mypy: ignore-errors

import functools
from collections.abc import Callable
from types import SimpleNamespace

import warp as wp

from workcell.ik.hjcd.gpu.chain import HUGE, D, Residual, Target, chain, pose_error
from workcell.ik.hjcd.kernels.newton import ITERATIONS, LONGEST_STEP, PROGRESS, ROUND

Gram = wp.types.matrix(shape=(6, 6), dtype=D)
_LONGEST = wp.constant(D(LONGEST_STEP))
_PROGRESS = wp.constant(D(PROGRESS))
_ROUND, _ITERATIONS = wp.constant(ROUND), wp.constant(ITERATIONS)
_TINY = wp.constant(D(1e-300))


@wp.func
def factor(A: Gram):
    """Cholesky factor in the lower triangle, with inverse diagonal; its first entry is -1 where there is none."""
    for j in range(6):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > D(1e-300):
            A[0, 0] = D(-1.0)
            return A
        inverse = D(1.0) / wp.sqrt(d)
        A[j, j] = inverse
        for i in range(j + 1, 6):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = total * inverse
    return A


@wp.func
def solve(A: Gram, b: Residual):
    """x with L L^T x = b, given `factor`."""
    x = b
    for i in range(6):
        total = x[i]
        for k in range(i):
            total -= A[i, k] * x[k]
        x[i] = total * A[i, i]
    for r in range(6):
        i = 5 - r
        total = x[i]
        for k in range(i + 1, 6):
            total -= A[k, i] * x[k]
        x[i] = total * A[i, i]
    return x


@functools.cache
def _algebra(n: int) -> SimpleNamespace:
    """Products with a Jacobian of n columns."""
    kinematics = chain(n)
    Vector, Columns = kinematics.Vector, kinematics.Columns
    N = wp.constant(n)

    @wp.func
    def pull_back(J: Columns, y: Residual):
        """J^T y."""
        return wp.transpose(J) * y

    @wp.func
    def freeze(q: Vector, bounds: wp.array2d(dtype=D), J: Columns, g: Vector):
        """1 for every joint that moves, 0 for one that the gradient pushes out of its limits."""
        free = Vector()
        for k in range(N):
            out = (q[k] >= bounds[1, k] and g[k] > D(0.0)) or (q[k] <= bounds[0, k] and g[k] < D(0.0))
            free[k] = wp.where(bounds[2, k] == D(0.0) and out, D(0.0), D(1.0))
        return free

    @wp.func
    def masked(J: Columns, free: Vector):
        """J with the columns of frozen joints struck out."""
        for k in range(N):
            if free[k] == D(0.0):
                for r in range(6):
                    J[r, k] = D(0.0)
        return J

    return SimpleNamespace(pull_back=pull_back, freeze=freeze, masked=masked)


@functools.cache
def _fallbacks(n: int) -> SimpleNamespace:
    """What is tried when the damped step fails."""
    kinematics = chain(n)
    Vector, Columns, forward, move = (
        kinematics.Vector,
        kinematics.Columns,
        kinematics.forward,
        kinematics.move,
    )
    N = wp.constant(n)

    @wp.func
    def cost_at(frames: wp.array2d(dtype=D), target: Target, q: Vector):
        """Squared residual at q."""
        _lines, R, p = forward(frames, q)
        e = pose_error(R, p, target)
        return wp.dot(e, e)

    @wp.func
    def dogleg(J: Columns, g: Vector, newton: Vector):
        """Steepest descent, then towards the Gauss-Newton step, on half its length (Eqs. 14-15); zero where flat."""
        image = J * g
        square, bent = wp.dot(g, g), wp.dot(image, image)
        if bent < D(1e-300) or square < D(1e-300):
            return Vector()
        radius = wp.min(D(0.1) * _LONGEST, D(0.5) * wp.length(newton))
        length = wp.min(square / bent, radius / wp.sqrt(square))
        step = length * g
        rest = radius - length * wp.sqrt(square)
        if rest > D(0.0):
            step = step + (rest / wp.max(wp.length(newton), D(1e-12))) * (newton - step)
        return step

    @wp.func
    def single(g: Vector):
        """A tenth of a radian of the joint with the largest gradient (Eq. 16)."""
        best = int(0)  # noqa: RUF046, UP018
        for k in range(N):
            if wp.abs(g[k]) > wp.abs(g[best]):
                best = k
        step = Vector()
        step[best] = wp.where(g[best] < D(0.0), D(-0.1), D(0.1))
        return step

    @wp.func
    def fall_back(
        frames: wp.array2d(dtype=D), bounds: wp.array2d(dtype=D), target: Target, q: Vector, cost: D,
        J: Columns, g: Vector, newton: Vector,
    ):  # fmt: skip
        """The first trial that lowers the cost: half and quarter step, dogleg, single joint; else the last."""
        trial = q
        reached = HUGE
        for attempt in range(4):
            if not reached < cost:
                step = newton
                share = D(1.0)
                if attempt == 0:
                    share = D(0.5)
                if attempt == 1:
                    share = D(0.25)
                if attempt == 2:
                    step = dogleg(J, g, newton)
                if attempt == 3:
                    step = single(g)
                trial = move(q, step, share, bounds)
                reached = cost_at(frames, target, trial)
        return trial, reached

    return SimpleNamespace(fall_back=fall_back)


@functools.cache
def newton(n: int) -> Callable[..., object]:
    """The function that polishes one configuration of n joints."""
    kinematics, algebra, fall_back = chain(n), _algebra(n), _fallbacks(n).fall_back
    Vector, forward, jacobian, move = (
        kinematics.Vector,
        kinematics.forward,
        kinematics.jacobian,
        kinematics.move,
    )
    pull_back, freeze, masked = algebra.pull_back, algebra.freeze, algebra.masked

    @wp.func
    def polish(
        frames: wp.array2d(dtype=D), bounds: wp.array2d(dtype=D), target: Target, accuracy: D, start: Vector
    ):
        """Where damped Newton steps lead from a start, and the squared residual there.

        Stops at a residual of `accuracy` metres (rotation weighted), when no step helps, or where progress is slow.
        """
        q = start
        lines, R, p = forward(frames, q)
        e = pose_error(R, p, target)
        cost = wp.dot(e, e)
        damping, mark = D(0.03), wp.copy(cost)
        iteration = int(0)  # noqa: RUF046, UP018
        while iteration < _ITERATIONS and cost >= accuracy * accuracy:
            if iteration % _ROUND == _ROUND - 1:
                if cost > _PROGRESS * mark:
                    break
                mark = cost
            J = jacobian(frames, lines, p)
            g = pull_back(J, e)
            free = freeze(q, bounds, J, g)
            J = masked(J, free)
            g = wp.cw_mul(g, free)
            A = J * wp.transpose(J)
            for r in range(6):
                A[r, r] = A[r, r] + damping * cost + D(1e-14)
            A = factor(A)
            if A[0, 0] < D(0.0):
                break
            step = pull_back(J, solve(A, e))
            step = wp.min(D(1.0), _LONGEST / wp.max(wp.length(step), _TINY)) * step
            left = e - J * step
            trial = move(q, step, D(1.0), bounds)
            lines, R, p = forward(frames, trial)
            e_trial = pose_error(R, p, target)
            reached = wp.dot(e_trial, e_trial)
            if reached < cost:
                gain = (cost - reached) / wp.max(cost - wp.dot(left, left), _TINY)
                if gain > D(0.9):
                    damping = damping * D(0.3)
                elif gain > D(0.5):
                    damping = damping * D(0.5)
                elif gain < D(0.25):
                    damping = damping * D(3.0)
            else:
                damping = damping * D(4.0)
                trial, reached = fall_back(frames, bounds, target, q, cost, J, g, step)
                if not reached < cost:
                    break
                lines, R, p = forward(frames, trial)
                e_trial = pose_error(R, p, target)
            damping = wp.min(wp.max(damping, D(1e-6)), D(1e4))
            cost = reached
            q = trial
            e = e_trial
            iteration = iteration + 1
        return q, cost

    return polish
