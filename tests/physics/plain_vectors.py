"""The functions of dem.vectors in plain Python."""

import numpy as np

EIGHT = 8


def load_eight(array: np.ndarray, first: int) -> np.ndarray:
    return array.reshape(-1)[first : first + EIGHT].copy()


def store_eight(array_out: np.ndarray, first: int, eight: np.ndarray) -> None:
    array_out.reshape(-1)[first : first + EIGHT] = eight


def eight_zeros(array: np.ndarray) -> np.ndarray:
    return np.zeros(EIGHT, array.dtype)


def add_eight(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a + b


def seen_from(place: np.ndarray, motion: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    one, other = motion[i], motion[j]
    apart = (place[j] - place[i])[:3].astype(motion.dtype)
    relative = (one - other)[:3]
    return (
        np.concatenate((apart, one[7:], relative, other[7:])),
        np.concatenate((one[3:7], other[3:7])),
    )


def opposite(on_i: np.ndarray, on_j: np.ndarray) -> np.ndarray:
    return np.concatenate((-on_i[:3], on_j[3:]))


def transposed(rows: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    return tuple(np.array(rows).T)


FUNCTIONS = {
    function.__name__: function
    for function in (load_eight, store_eight, eight_zeros, add_eight, seen_from, opposite, transposed)
}
