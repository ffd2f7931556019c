"""The musculoskeletal hand: model, environment, policies, rollouts, training and synergies."""
