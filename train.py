"""Train a steering policy and say how good it is.

    python train.py                                  # PPO on MagWire/Steer-v1, about a minute on two cores
    python train.py --algorithm sac --seed 3
    python train.py --run runs/mine --resume         # go on where a run stopped

`magwire train` does the same. A run has four steps, which agents/cli/train.py has in this order:

1. learn, with evaluations and checkpoints on the way
2. evaluate the best model beside the paper's own policy and two floors
3. write the results and print the table
4. draw what the best model does

Everything is written to one run folder: config.json, versions.json, checkpoints, the best model with its normalisation,
learning_curve.png, results.json, path.png, arclength.png, episode.mp4, TensorBoard logs.
"""

from agents.cli.train import main

if __name__ == "__main__":
    main(__doc__)
