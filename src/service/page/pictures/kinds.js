// What tells the pictures apart.

// The view that a user gave.
export const viewOf = (specification) => {
  const { view } = specification;
  return view && typeof view === "object" && Object.keys(view.points ?? {}).length > 0 ? view : null;
};

// The two states of a problem that has no others.
export function statesOf(specification) {
  const [problem] = Object.values(specification.problem);
  const names = Object.keys(problem?.states ?? {});
  return names.length === 2 && names.every((name) => !name.includes("[")) ? names : null;
}
