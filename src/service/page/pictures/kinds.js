// Properties of a specification that decide which picture it gets.

// Returns the view that a user has given in the specification, or null.
export const viewOf = (specification) => {
  const { view } = specification;
  return view && typeof view === "object" && Object.keys(view.points ?? {}).length > 0 ? view : null;
};

// Returns the names of the two states of a problem that has exactly two, for a phase plane, or null.
export function statesOf(specification) {
  const [problem] = Object.values(specification.problem);
  const names = Object.keys(problem?.states ?? {});
  return names.length === 2 && names.every((name) => !name.includes("[")) ? names : null;
}
