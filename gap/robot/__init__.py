"""Causes that the joints of a robot share, sought over all joints together: masses, payload, inertia, a tilted base."""
