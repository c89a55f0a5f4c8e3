"""What a structure's forces are made of.

A term gives forces, energy, tangent blocks and a mass bound of one kind of thing; the system sums them. Only terms that a structure
has exist: the others allocate nothing and compile nothing.

*Element terms* own their fields and their loop. Each end of an element has a slot, each two of its ends a pair:

``count()``
    how many elements;
``store_forces(e)``
    writes the force on each end to its slot;
``energy(e)``
    stored energy, and work of loads that belong to the elements;
``store_bounds(e)``
    writes to the first component of each slot a stiffness k, such that masses M ≥ ½ Σ k are stable (:mod:`element`);
``store_blocks(e, slot_block, pair_block)``
    writes -∂f/∂x of each end to its slot, and of the two ends of each pair (rows, columns) to the pair.

*Node terms* act on one node at a time and are inlined where it gathers: ``force(i)``, ``energy(i)``, ``bound(i)``, ``block(i)``,
with M ≥ ¼ ``bound``, as nothing at another end counts it a second time.

*Global terms* couple many nodes. They stay on the host and wrap the sparse factor: gas in shut chambers and liquids of given volume
(:mod:`contents`, added by :mod:`coupled`) and, outside of those, loads on the surface that have no potential (:mod:`rim`).

Loads on the surface (:mod:`pressure`, :mod:`snow`, :mod:`water`) are inlined in the triangles' loop, which has the sides at hand.
"""

from __future__ import annotations

from typing import Any, Protocol

from taichi_membrane.mechanics.structure import Structure


class Term(Protocol):
    """What is asked of element and node terms on the host; the rest of each, above, is device code."""

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure of the same features fits its fields."""

    def upload(self, structure: Structure) -> None:
        """Take over a structure's data."""


class ElementTerm(Term, Protocol):
    """Elements with ends."""

    @property
    def count(self) -> Any: ...
    @property
    def store_forces(self) -> Any: ...
    @property
    def energy(self) -> Any: ...
    @property
    def store_bounds(self) -> Any: ...
    @property
    def store_blocks(self) -> Any: ...


class NodeTerm(Term, Protocol):
    """Something that acts at each node by itself."""

    @property
    def force(self) -> Any: ...
    @property
    def energy(self) -> Any: ...
    @property
    def bound(self) -> Any: ...
    @property
    def block(self) -> Any: ...
