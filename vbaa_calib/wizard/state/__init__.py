"""What the wizard knows and keeps: questions, answers, pictures, and what follows from them."""
