"""How learned embeddings are trained: needs torch, which no other module of `embeddings` imports."""
