export const title = "Folder";
export async function show(place, app) { return null; }
