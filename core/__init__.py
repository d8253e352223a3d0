"""The algorithm: from one levelled depth frame to vertical planes and layered prisms. No clock, file or socket."""
