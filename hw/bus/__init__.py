"""The wire: servos on a bus, their memory, packets and readings, of any make and on any number of adapters."""
