"""Frames of beams by finite elements in nodal coordinates: textbook matrices (Przemieniecki, Theory of Matrix
Structural Analysis, sections 5.6 and 11.6, without shear), assembled in the axes of the ground, without a robot."""

from itertools import pairwise

import numpy as np
from scipy.linalg import eigh


def local_matrices(L, A, I_y, I_z, I_0, I_p, E, G, rho, rotary=True):
    """Return (mass, stiffness) (12, 12) of a beam along x: displacements and rotations of one end, then the other."""
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    for axial, stiff, inert in ((0, E * A / L, rho * A * L / 6), (3, G * I_0 / L, rho * I_p * L / 6)):
        at = np.ix_([axial, axial + 6], [axial, axial + 6])
        K[at] = stiff * np.array([[1, -1], [-1, 1]])
        M[at] = inert * np.array([[2, 1], [1, 2]])
    for places, second, sign in (([1, 5, 7, 11], I_z, 1), ([2, 4, 8, 10], I_y, -1)):
        s = np.outer([1, sign, 1, sign], [1, sign, 1, sign])
        bend = np.array(
            [
                [12, 6 * L, -12, 6 * L],
                [6 * L, 4 * L**2, -6 * L, 2 * L**2],
                [-12, -6 * L, 12, -6 * L],
                [6 * L, 2 * L**2, -6 * L, 4 * L**2],
            ]
        )
        move = np.array(
            [
                [156, 22 * L, 54, -13 * L],
                [22 * L, 4 * L**2, 13 * L, -3 * L**2],
                [54, 13 * L, 156, -22 * L],
                [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
            ]
        )
        turn = np.array(
            [
                [36, 3 * L, -36, 3 * L],
                [3 * L, 4 * L**2, -3 * L, -(L**2)],
                [-36, -3 * L, 36, -3 * L],
                [3 * L, -(L**2), -3 * L, 4 * L**2],
            ]
        )
        K[np.ix_(places, places)] = E * second / L**3 * bend * s
        M[np.ix_(places, places)] = (rho * A * L / 420 * move + rotary * rho * second / (30 * L) * turn) * s
    return M, K


class Frame:
    """Nodes with six displacements in the axes of the ground, some of them shared: a hinge shares all but one."""

    def __init__(self):
        self.size, self.positions, self.numbers, self.beams, self.bodies, self.fixed = 0, [], [], [], [], set()
        self.described = []  # (numbers of both ends, section) of each element

    def node(self, position, clamped=False):
        numbers = list(range(self.size, self.size + 6))
        self.size += 6
        self.fixed |= set(numbers) if clamped else set()
        return self._add(position, numbers)

    def hinge(self, node, component=5):
        """Add a node at another one, with a free rotation about one axis of the ground (3: x, 4: y, 5: z)."""
        numbers = list(self.numbers[node])
        numbers[component] = self.size
        self.size += 1
        return self._add(self.positions[node], numbers)

    def _add(self, position, numbers):
        self.positions.append(np.asarray(position, dtype=float))
        self.numbers.append(numbers)
        return len(self.positions) - 1

    def beam(self, a, b, section, z=(0, 0, 1), elements=1):
        """Add a beam from node a to b. section: arguments of local_matrices after L; z: near its z axis."""
        ends = [
            a,
            *(
                self.node(self.positions[a] + (self.positions[b] - self.positions[a]) * k / elements)
                for k in range(1, elements)
            ),
            b,
        ]
        for first, second in pairwise(ends):
            along = self.positions[second] - self.positions[first]
            L = np.linalg.norm(along)
            x = along / L
            y = np.cross(z, x)
            y /= np.linalg.norm(y)
            R = np.kron(np.eye(4), np.array([x, y, np.cross(x, y)]))
            M, K = (R.T @ matrix @ R for matrix in local_matrices(L, *section))
            self.described.append(((self.numbers[first], self.numbers[second]), section))
            self.beams.append((self.numbers[first] + self.numbers[second], M, K))

    def matrices(self):
        M, K = np.zeros((self.size, self.size)), np.zeros((self.size, self.size))
        for numbers, mass, stiffness in [*self.beams, *self.bodies]:
            M[np.ix_(numbers, numbers)] += mass
            K[np.ix_(numbers, numbers)] += stiffness
        kept = [number for number in range(self.size) if number not in self.fixed]
        return M[np.ix_(kept, kept)], K[np.ix_(kept, kept)]

    def mass(self, node, mass, inertia=0.0):
        """Add a ball with its centre at a node; inertia: about any axis."""
        matrix = np.zeros((6, 6))
        matrix[:3, :3], matrix[3:, 3:] = mass * np.eye(3), inertia * np.eye(3)
        self.bodies.append((self.numbers[node], matrix, np.zeros((6, 6))))

    def frequencies(self):
        """Return the natural frequencies [Hz], ascending."""
        M, K = self.matrices()
        return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0)) / (2 * np.pi)
