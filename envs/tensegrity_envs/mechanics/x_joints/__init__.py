"""What all arms of X-joints (anti-parallelograms) share: one joint, and the inverse kinematics of two in series."""
