"""Which of the people in view is the one to follow: chosen once, then kept, and never swapped in silence."""
