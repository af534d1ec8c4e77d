  return (element, data) => {
    const root = element.attachShadow({ mode: "open" }), $ = name => root.getElementById(name);
    root.innerHTML = HTML;
    const arm = Arm.made(data.arm), names = Object.keys(data.motions);
    const tracks = Object.fromEntries(names.map(name => [name, Arm.track(data.motions[name], arm.joints)]));
    for (const name of names) for (const choice of ["which", "beside"]) $(choice).add(new Option(name, name));
    return Player($, data, arm, tracks, root);
  };
