"""What the paper's theorems say of a scenario, and its errors."""
