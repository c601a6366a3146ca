"""From a bag to the steady shapes of an experiment. Imports bags and core."""
