"""The paper's experiments in simulation, its tables and findings beside ours."""
