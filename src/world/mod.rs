//! The rollout: controls, noise, schedule, KV ring, sampler, autoencoder, state.
