"""Better postures and paths: what the arm should do so that no fault takes the task."""
