"""Many postures: kernels that know arrays only, and the sweep that runs them in chunks."""
