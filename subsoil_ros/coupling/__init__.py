"""How soil and mechanism exchange motion and force, and how a run goes from tick to tick."""
