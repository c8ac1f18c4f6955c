"""Where two records differ, in words."""

from typing import Any

_LONGEST = 60


def differences(before: Any, now: Any, path: str = "") -> list[str]:
    """Each place where plain values differ, as 'field was A, is now B', outermost fields in the order of `now`."""
    if isinstance(before, dict) and isinstance(now, dict):
        found = []
        for key in [*now, *(key for key in before if key not in now)]:
            here = f"{path}.{key}" if path else str(key)
            if key not in before or key not in now:
                found.append(f"{here} was {_show(before, key)}, is now {_show(now, key)}")
            else:
                found += differences(before[key], now[key], here)
        return found
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        return [d for k, (a, b) in enumerate(zip(before, now, strict=True)) for d in differences(a, b, f"{path}.{k}")]
    same = type(before) is type(now) and before == now
    return [] if same else [f"{path} was {_short(before)}, is now {_short(now)}"]


def _show(mapping: dict[str, Any], key: str) -> str:
    return _short(mapping[key]) if key in mapping else "absent"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
