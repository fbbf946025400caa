"""How the labs for students are solved: for teachers, in a clone of the project; the wheel is made without it."""
