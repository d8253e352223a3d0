"""From depth, attitude and pose to published models: matching in time, extraction, transforms, messages."""
