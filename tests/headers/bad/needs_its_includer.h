// Bad on purpose: uses std::string without including it. tests/headers must reject this header.
#pragma once

inline std::string Name() { return "bad"; }
