"""Every identity of docs/corrections.md, by SymPy: generic symbols, or exact random numbers."""

import random

import pytest
import sympy as sp

T = sp.Symbol("t", real=True)
BETA, W, W_DOT = sp.symbols("beta w wdot", real=True)


def zero(expression):
    """Whether an expression, or every entry of a matrix, is zero identically."""
    entries = list(expression) if isinstance(expression, sp.MatrixBase) else [expression]
    return all(sp.expand(sp.together(entry).as_numer_denom()[0]) == 0 for entry in entries)


def column(name, size=3):
    return sp.Matrix(sp.symbols(f"{name}1:{size + 1}", real=True))


def symmetric(name, size=3):
    """A generic symmetric matrix."""
    return sp.Matrix(size, size, lambda i, j: sp.Symbol(f"{name}{min(i, j)}{max(i, j)}", real=True))


def weights(size=3):
    """Generic b_ji = b_ij of the complete graph; other graphs have some of them zero."""
    return sp.Matrix(
        size, size, lambda i, j: 0 if i == j else sp.Symbol(f"b{min(i, j)}{max(i, j)}", real=True)
    )


def degrees(a):
    return sp.diag(*(sum(a.row(i)) for i in range(a.rows)))


def dot(a, b):
    return (a.T * b)[0]


class Group:
    """Robots in the variables of Eq. 8: N stands for L + diag μ, u = η + ũ, rates by Eq. 9."""

    def __init__(self, n, *, compensated=False, printed_delta=False):
        size = n.rows
        self.n = n
        self.z1, self.z2, self.z3 = (column(name, size) for name in ("x", "y", "z"))
        self.e1, self.e2 = column("p", size), column("q", size)  # ũ
        self.zeta2 = self.z2 - BETA * W * self.z3
        d = sp.Matrix(size, 1, lambda j, _: (self.z2[j] * BETA * W + self.z3[j]) * self.zeta2[j])
        self.s = self.z1 + d
        delta = -d if printed_delta else d
        self.first = -n * (self.z1 + delta) + self.e1  # u1 − w1
        eta2 = -n * self.z2 - BETA * W * (W * self.z2 - BETA * W**2 * self.z3)
        eta2 -= BETA * W_DOT * self.z3
        if compensated:
            eta2 -= W * self.z3
        self.u2 = eta2 + self.e2
        turn = sp.Matrix(size, 1, lambda j, _: self.first[j] * self.zeta2[j])
        self.z1_dot = self.first
        self.z3_dot = -BETA * W**2 * self.z3 + W * self.z2 + turn
        self.z2_dot = (
            self.u2
            + BETA * W * (-BETA * W**2 * self.z3 + W * self.z2)
            + BETA * W_DOT * self.z3
            + BETA * W * turn
        )
        self.zeta2_dot = self.u2

    def v_dot(self):
        """That of Eq. 22."""
        return dot(self.z1, self.z1_dot) + dot(self.z2, self.z2_dot) + dot(self.z3, self.z3_dot)

    def kinematic(self):
        """With ũ = 0."""
        return dict.fromkeys((*self.e1, *self.e2), 0)


# --- Eq. 9, and the sign of Δ ----------------------------------------------------------------


def moving(kappa, sigma):
    """ζ2, ζ3 as functions of time with ζ̇2 = u2, ζ̇3 = κ u1 ζ2, and z2 = ζ2 + σ β w1 ζ3."""
    zeta2, zeta3, w, u1, u2 = (sp.Function(name)(T) for name in ("a", "b", "w", "u", "v"))
    z2, z3 = zeta2 + sigma * BETA * w * zeta3, zeta3
    rates = {sp.Derivative(zeta2, T): u2, sp.Derivative(zeta3, T): kappa * u1 * zeta2}
    return zeta2, w, u1, u2, z2, z3, rates


def test_eq_9_follows_from_eq_8_along_eq_6():
    x, y, theta, v, omega, w = (sp.Function(n)(T) for n in ("x", "y", "theta", "v", "omega", "w"))
    along = {
        sp.Derivative(x, T): v * sp.cos(theta),
        sp.Derivative(y, T): v * sp.sin(theta),
        sp.Derivative(theta, T): omega,
    }
    zeta2 = x * sp.cos(theta) + y * sp.sin(theta)
    z3 = y * sp.cos(theta) - x * sp.sin(theta)
    u1, u2 = -omega, v + z3 * omega
    z2 = zeta2 + BETA * w * z3
    w_dot = sp.Derivative(w, T)
    z2_dot = u2 + BETA * w * (-BETA * z3 * w**2 + w * z2) + BETA * z3 * w_dot
    z2_dot += (u1 - w) * BETA * w * zeta2
    z3_dot = -BETA * z3 * w**2 + z2 * w + (u1 - w) * zeta2
    for value, rate in ((zeta2, u2), (z3, u1 * zeta2), (z2, z2_dot), (z3, z3_dot)):
        assert sp.simplify(sp.diff(value, T).subs(along) - rate) == 0


def test_the_sign_of_eq_19_is_no_convention():
    """ż3 = −β w1² z3 + ... forces κσ = 1; then u1 − w1 has ζ2 (β w1 z2 ± z3), never two minuses."""
    for kappa in (1, -1):
        for sigma in (1, -1):
            zeta2, w, u1, _, z2, z3, rates = moving(kappa, sigma)
            z2_dot, z3_dot = (sp.expand(sp.diff(z, T).subs(rates)) for z in (z2, z3))
            # At u1 = w1 the rate of z3, in z2 and z3.
            at_rest = sp.expand(z3_dot.subs(u1, w).subs(zeta2, z2 - sigma * BETA * w * z3))
            settles = sp.expand(at_rest - kappa * w * z2 + BETA * w**2 * z3) == 0
            assert settles == (kappa * sigma == 1)
            of_u1 = sp.diff(z2_dot, u1) * z2 + sp.diff(z3_dot, u1) * z3
            if settles:
                assert zero(of_u1 - zeta2 * (BETA * w * z2 + kappa * z3))


def test_the_corrected_delta_cancels_and_the_printed_one_adds_d_l_d():
    n = symmetric("n")
    group = Group(n)
    kinematic = group.kinematic()
    others = -dot(group.z2, n * group.z2) - BETA * W**2 * dot(group.z3, group.z3)
    others += W * dot(group.z2, group.z3)
    found = group.v_dot().subs(kinematic)
    assert zero(found - (others - dot(group.s, n * group.s)))
    printed = Group(n, printed_delta=True)
    d = group.s - group.z1
    assert zero(
        printed.v_dot().subs(kinematic) - (others - dot(group.z1, n * group.z1) + dot(d, n * d))
    )


def test_compensation_removes_the_cross_term():
    n = symmetric("n")
    group = Group(n, compensated=True)
    claimed = -dot(group.s, n * group.s) - dot(group.z2, n * group.z2)
    claimed -= BETA * W**2 * dot(group.z3, group.z3)
    assert zero(group.v_dot().subs(group.kinematic()) - claimed)


def test_a_quarter_is_sharp_for_v():
    """−λx² − βy² + xy, y = w1 z3, along an eigenvector, is definite for βλ > 1/4 alone."""
    lam, x, y = sp.symbols("lambda x y", positive=True)
    form = sp.Matrix([[lam, -sp.Rational(1, 2)], [-sp.Rational(1, 2), BETA]])
    assert zero(form.det() - (BETA * lam - sp.Rational(1, 4)))
    worst = (-lam * x**2 - BETA * y**2 + x * y).subs(x, y / (2 * lam))
    assert zero(worst - y**2 * (1 - 4 * BETA * lam) / (4 * lam))


# --- V* --------------------------------------------------------------------------------------


def star_rate(group, inverse):
    """V̇ + d/dt ζ2ᵀ N⁻¹ ζ2 / (2β)."""
    return group.v_dot() + dot(group.zeta2, inverse * group.zeta2_dot) / BETA


@pytest.mark.long
def test_v_star_falls_with_the_printed_cross_term():
    """N of three robots is the inverse of a generic symmetric matrix; w1 varies."""
    inverse = symmetric("i")
    n = inverse.inv()
    group = Group(n)
    claimed = -dot(group.s, n * group.s) - dot(group.z2, n * group.z2)
    claimed += -dot(group.zeta2, group.zeta2) / BETA - W**2 * dot(
        group.zeta2, inverse * group.zeta2
    )
    claimed -= W_DOT * dot(group.zeta2, inverse * group.z3)
    assert zero(star_rate(group, inverse).subs(group.kinematic()) - claimed)


def test_v_star_at_the_dynamic_level():
    """Eq. 33's −Λ takes Sᵀũ1 + z2ᵀũ2 away; ζ2ᵀN⁻¹ũ2/β − ũᵀKũ remains of ũ."""
    inverse = symmetric("i", 2)
    n = inverse.inv()
    group = Group(n)
    passive = -dot(group.s, group.e1) - dot(group.z2, group.e2)  # d/dt ½ũᵀM̄ũ + ũᵀKũ
    claimed = star_rate(group, inverse).subs(group.kinematic())
    claimed += dot(group.zeta2, inverse * group.e2) / BETA
    assert zero(star_rate(group, inverse) + passive - claimed)


def test_the_gain_that_theorem_4_needs():
    """For an eigenvalue λ of N; a smaller one needs more. K shaped by the inertia has no bound."""
    k, lam, beta, w = sp.symbols("k lambda beta w", positive=True)
    off = -1 / (2 * beta * lam)
    form = sp.Matrix([[1 / beta + w**2 / lam, off], [off, k]])
    needed = 1 / (4 * beta * lam * (lam + beta * w**2))
    assert zero(form.det() - (1 / beta + w**2 / lam) * (k - needed))
    assert sp.diff(needed, lam).is_negative
    m, inertia, z3 = sp.symbols("m I z3", positive=True)
    shaped = k * sp.Matrix([[m * z3**2 + inertia, m * z3], [m * z3, m]])
    least = 1 / shaped.inv()[1, 1]  # of ũᵀKũ for ũ2 = 1
    assert zero(least - k * m * inertia / (m * z3**2 + inertia))
    assert sp.limit(least, z3, sp.oo) == 0


@pytest.mark.long
def test_theorem_1_with_the_pseudoinverse():
    """L of any graph on three robots, its weights symbols."""
    a = weights()
    laplacian = degrees(a) - a
    ones = sp.ones(3, 3) / 3
    inverse = (laplacian + ones).inv().applyfunc(sp.cancel) - ones  # L⁺
    assert zero(laplacian * inverse * laplacian - laplacian)
    group = Group(laplacian)
    kinematic = group.kinematic() | {W_DOT: 0}
    mean2, mean_zeta = sum(group.z2) / 3, sum(group.zeta2) / 3
    claimed = -dot(group.s, laplacian * group.s) - dot(group.z2, laplacian * group.z2)
    claimed += -dot(group.zeta2, group.zeta2) / BETA
    claimed += -(W**2) * dot(group.zeta2, inverse * group.zeta2) + 3 * mean2 * mean_zeta / BETA
    assert zero(star_rate(group, inverse).subs(kinematic) - claimed)
    assert zero(sum(group.zeta2_dot.subs(kinematic)) / 3 + BETA * W**2 * mean_zeta)
    # The mean of z2 moves by what tends to zero, (u1 − w1) ζ2, alone: it has a limit c2.
    turn = sum(group.first[j] * group.zeta2[j] for j in range(3)).subs(kinematic)
    assert zero(sum(group.z2_dot.subs(kinematic)) - BETA * W * turn)


def test_the_circle_of_theorem_1():
    """Where ζ2 = 0 and z2 = c2, z3 = c2/(β w1) rests, and the robot circles about its place."""
    c2, start = sp.symbols("c2 theta0", real=True)
    z3 = c2 / (BETA * W)
    assert zero(-BETA * W**2 * z3 + W * c2)  # ż3 of Eq. 9 at u1 = w1
    theta = start - W * T
    x, y = -z3 * sp.sin(theta), z3 * sp.cos(theta)  # of Eq. 8 with ζ2 = 0
    assert sp.simplify(x**2 + y**2 - z3**2) == 0
    speed = sp.diff(x, T) * sp.cos(theta) + sp.diff(y, T) * sp.sin(theta)
    assert sp.simplify(speed - W * z3) == 0
    assert sp.diff(theta, T) == -W
    assert not zero(BETA * W**2 * z3**2)  # Eq. 23


# --- Theorem 3 -------------------------------------------------------------------------------


def test_theorem_3_brings_the_centroid_home():
    """Where ũ rests at zero, Eq. 33 leaves −Λ, which is not relative: S = z2 = 0.

    The slowest of it, near the goal: m s² + k s + 1, K the identity, and m s² + k m s + 1, K shaped.
    """
    m, inertia, k, s, z3 = sp.symbols("m I k s z3", positive=True)
    inertias = sp.Matrix([[m * z3**2 + inertia, m * z3], [m * z3, m]])  # M̄
    assert zero(inertias.det() - m * inertia)
    for gain, expected in (
        (k * sp.eye(2), m * s**2 + k * s + 1),
        (k * inertias, m * s**2 + k * m * s + 1),
    ):
        matrices = [matrix.subs(z3, 0) for matrix in (inertias, gain)]
        # M̄ũ̇ = −Kũ − Λ, and of means: ż2 = ũ2, Ṡ = ũ1 to first order at z = 0.
        second = (s * matrices[0] + matrices[1])[1, 1] * s + 1
        assert zero(second - expected)


def test_the_robust_term_gains_at_most_rho_epsilon():
    rho, x, e = sp.symbols("rho x e", positive=True)
    gain = rho * x - rho * x**2 / (x + e)  # −ũᵀȲ(a − ā) ≤ ρ‖Ȳᵀũ‖
    assert zero(gain - rho * x * e / (x + e))
    assert sp.simplify(rho * e - gain).is_positive


# --- Eqs. 40, 41 -----------------------------------------------------------------------------


def test_eq_41_holds_with_a_delay_for_each_link():
    """S_i and z2_i at t − δ_ji are symbols of their own for every link; μ and b are generic."""
    size = 3
    a, mu = weights(size), column("m", size)
    old = {name: symmetric_free(name, size) for name in ("o", "r")}  # S_i, z2_i as j hears them
    group = Group(sp.zeros(size, size))
    s, z2, z3 = group.s, group.z2, group.z3
    pairs = [(j, i) for j in range(size) for i in range(size) if i != j]
    pull = [
        sp.Matrix(
            size,
            1,
            lambda j, _, k=k: (
                -mu[j] * (s, z2)[k][j]
                - sum(a[j, i] * ((s, z2)[k][j] - old["or"[k]][j, i]) for i in range(size) if i != j)
            ),
        )
        for k in (0, 1)
    ]
    rate = group.v_dot().subs(
        dict(zip((*group.e1, *group.e2), (*pull[0], *pull[1]), strict=True)), simultaneous=True
    )
    for j, i in pairs:  # of the integrals of Eq. 40
        rate += a[j, i] * (s[i] ** 2 + z2[i] ** 2 - old["o"][j, i] ** 2 - old["r"][j, i] ** 2) / 2
    claimed = -BETA * W**2 * dot(z3, z3) + W * dot(z2, z3)
    claimed -= sum(mu[j] * (s[j] ** 2 + z2[j] ** 2) for j in range(size))
    for j, i in pairs:
        gaps = (s[j] - old["o"][j, i]) ** 2 + (z2[j] - old["r"][j, i]) ** 2
        claimed -= a[j, i] * gaps / 2
    assert zero(rate - claimed)


def symmetric_free(name, size):
    """A generic matrix: an entry for each direction of each link."""
    return sp.Matrix(size, size, lambda i, j: sp.Symbol(f"{name}{i}{j}", real=True))


def test_what_eq_41_leaves_of_z2_at_least():
    """½ Σ b_ji (x_j − y_i)² over y: its minimum, at y = D⁻¹ A x, is ½ xᵀ(D − A D⁻¹ A)x."""
    a = weights()
    d = degrees(a)
    x, y = column("x"), column("y")
    form = sum(a[j, i] * (x[j] - y[i]) ** 2 for j in range(3) for i in range(3)) / 2
    least = d.inv() * a * x
    assert zero(
        sp.Matrix([sp.diff(form, y[i]) for i in range(3)]).subs(dict(zip(y, least, strict=True)))
    )
    assert zero(form.subs(dict(zip(y, least, strict=True))) - dot(x, (d - a * d.inv() * a) * x) / 2)
    assert zero(sp.hessian(form, list(y)) - d)  # positive: a minimum


def test_where_the_graph_is_bipartite_nothing_is_left():
    """±1 by side and 1 are both in the kernel of D − A D⁻¹ A: one damped robot is not enough."""
    seed = 20
    draw = random.Random(seed)
    print(f"seed {seed}")
    for _ in range(20):
        left, right = draw.randint(1, 3), draw.randint(1, 3)
        size = left + right
        a = sp.zeros(size, size)
        for i in range(left):
            for j in range(left, size):
                a[i, j] = a[j, i] = sp.Rational(draw.randint(1, 9), draw.randint(1, 9))
        d = degrees(a)
        form = d - a * d.inv() * a
        sides = sp.Matrix([1] * left + [-1] * right)
        assert zero(form * sides)
        assert zero(form * sp.ones(size, 1))
