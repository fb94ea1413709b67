"""The equations of the lattice, each written once: link, contact, floor, fluid, enclosure, motion, group."""
