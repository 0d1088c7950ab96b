"""The multibody coach as truth: recordings from it diagnosed in one dimension, policies, the paper's tables, pictures."""
