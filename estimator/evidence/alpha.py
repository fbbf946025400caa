"""How often a trace may be wrong: the one number on which every name that is given depends."""

#: Probability of any false name, over all candidates together (Bonferroni), where the user asks for no other: a stated
#: risk.
ALPHA = 0.01
