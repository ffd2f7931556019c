"""Where people already are: thin adapters to other tools, each an optional extra that is imported when used.

optuna_sampler   an Optuna sampler; storage, dashboard and constraints are Optuna's
mlflow_callback  one's own study as a run of MLflow
"""
