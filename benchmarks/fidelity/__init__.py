"""How well the model stands for what is there."""
